"""What the user writes: the schema of a spec file, its loader, and the built-in specs."""
