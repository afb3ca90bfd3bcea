"""A model as a file that other controllers play: C, LinuxCNC, FMU, structured text, tables."""
