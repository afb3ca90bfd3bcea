"""Colours of every figure, after Okabe and Ito (jfly.uni-koeln.de/color, 2008): safe for the colour-blind.

A colour means one thing everywhere: measured is dark, the model blue, before orange, after blue, a
bound or a guide grey, a floor green.
"""

INK = "#1f2933"
MUTED = "#5f6b7a"
GRID = "#e4e8ee"
MEASURED = "#3b4754"
MODEL = "#0072b2"
BEFORE = "#d55e00"
AFTER = "#0072b2"
REFERENCE = "#8a94a3"
GOOD = "#009e73"
ACCENT = "#cc79a7"
SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#3b4754")

# The Rerun viewer is dark: the same hues, lighter.
GREY_ON_DARK, BLUE_ON_DARK, ORANGE_ON_DARK = "#aab4c0", "#56b4e9", "#e69f00"
GREEN_ON_DARK, PINK_ON_DARK, RED_ON_DARK = "#2fbf95", "#e39fc6", "#ff6f59"
