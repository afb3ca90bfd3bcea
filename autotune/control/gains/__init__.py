"""Gains judged and proposed: sampled margins, the nonlinear loop on the twin, hunting, stick-slip (chapter 4)."""
