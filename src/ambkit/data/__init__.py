"""What was measured or simulated: the record, and how logs of any format become one."""
