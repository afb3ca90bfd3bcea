"""What the axis is made to do, the guard that watches it, the runner."""
