"""Experiments on wsp_env: benchmarks, convergence, the seed paper's results."""
