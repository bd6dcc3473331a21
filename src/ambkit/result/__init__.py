"""What a verb returns: rows, series and figures, and the tellers that show them."""
