"""What takes more than one room: tuning, the check of any file, the paper reproduced."""
