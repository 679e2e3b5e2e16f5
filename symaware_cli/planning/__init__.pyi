# What other rooms use of this one.

from .optimal_control.linear_dynamics import LinearDynamics as LinearDynamics
