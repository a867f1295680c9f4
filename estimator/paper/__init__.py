"""The paper's formulas and the systems around it, as baselines."""
