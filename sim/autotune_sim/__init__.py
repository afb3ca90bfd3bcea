"""Simulated axis: plant, firmware, CANopen node, faults."""
