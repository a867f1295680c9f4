"""The paper's formulas, and related systems as baselines."""
