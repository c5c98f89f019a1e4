"""The free rod beside other solvers on the cases of cosseratbench: ``python -m tests.cosserat``."""
