"""EI from one photograph of a bent rod."""
