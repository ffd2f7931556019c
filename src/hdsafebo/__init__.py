"""Safe Bayesian optimisation for the control of high-dimensional embodied systems."""

__version__ = "0.1.0"
