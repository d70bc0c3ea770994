"""Words and pictures, made from records only: nothing here computes or decides."""
