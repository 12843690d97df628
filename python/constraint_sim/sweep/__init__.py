"""Studies: many scenes, methods and parameters. docs/sweeps.md is the manual."""
