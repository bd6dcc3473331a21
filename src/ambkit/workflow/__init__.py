"""What the commands decide, as Python: who is asked, tuned, judged on what."""
