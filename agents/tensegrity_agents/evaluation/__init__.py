"""Evaluation on fixed episodes, paired across controllers."""
