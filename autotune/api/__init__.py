"""What `autotune` offers by name, see the package itself; loaded when a name is used for the first time."""
