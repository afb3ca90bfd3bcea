"""What every fit shares: prepared recordings, the controller, the twin, the residual, least squares, hold-outs."""
