"""Contact laws beside the degraded one, each as the plant takes it: a record of floats and a compiled function."""
