"""The force as points, a grid or a surface: measured, or computed by other tools."""
