"""What Poise computes with: the spec file, the model, its analysis, the solver doors, and presentation.

Symbols, as in the paper; equation numbers in docstrings, "(13)", are the paper's too.

=========  ==========================================================  =========
symbol     meaning                                                     unit
=========  ==========================================================  =========
M, m       mass of the body, of the foot                               kg
L          ankle to centre of gravity of the body                      m
I          inertia of the body about the ankle                         kg m²
ell        ankle to toe, and ankle to heel; half the foot's length     m
theta      ankle angle from the vertical, toe side positive            rad
omega      its rate                                                    rad/s
tau        ankle torque                                                N m
F_x, F_y   external force, forward and up                              N
F_T, F_H   vertical ground reaction at the toe, at the heel            N
f_y        vertical force of the body on the foot                      N
A          size of gravity and external force together, (3)            N
theta_f    its direction, (4): the posture that needs no torque        rad
s          memory of a law: tau_f, the integral of F_H - F_T (9) for   N s, m s
           law (8); the integral of P_d - P_CoP for law (20)
K_p        gain on the angle                                           N m/rad
K_d        gain on the rate                                            N m s/rad
K_f        gain on the integral of (8); K_F = K_f (M+m) g/ell in (20)  m/s
P, P_d     centre of pressure (CoP) from the ankle, toe positive; the  m
           target of its law
l_T, l_H   ankle to toe, ankle to heel, where they differ              m
h          height of the ankle above the ground                        m
kappa      m/M where slopes load the foot too, else 0                  1
beta       what I grows by where K_f is (``design.model.standing``)    kg m²
alpha      slope of the ground                                         rad
sigma      decay rate: every pole has a real part of at most -sigma    1/s
=========  ==========================================================  =========

Imports point one way: ``cli`` asks ``problems``, ``problems`` compute with ``design``. Inside, ``model`` and
``solvers`` know nothing of the others, ``spec`` builds records of ``model``, ``analysis`` uses both, and
``present`` reads stored records only. ``recordings`` turns files of measured trials into records of their own.
"""

__version__ = "0.1.0"
