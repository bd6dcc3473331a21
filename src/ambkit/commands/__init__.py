"""The commands, one module each. They read arguments and print; the work is in the library."""
