"""The paper, (1)-(29): the biped, its surroundings, the laws, what limits them, and linear stability."""
