"""The loop that plays episodes, one evaluator for every policy, the sweep of disturbances, the statistics."""

from .evaluator import Episodes, evaluate, table

__all__ = ["Episodes", "evaluate", "table"]
