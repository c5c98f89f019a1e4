"""The benchmark: a plan of cells, what a cell computes, the jobs that run them, and the report."""
