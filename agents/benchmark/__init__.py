"""Which policies meet where, one piece of that work, the jobs that do it, the report."""
