"""What is believed: kernels, Gaussian processes and their fits, the surrogate of a problem, and the safe set.

Everything here follows from data and hyper-parameters; nothing decides where to evaluate next.
`safe_set` has the bound mu + beta sigma >= h and what it promises; `surrogate` has one process per function.
"""
