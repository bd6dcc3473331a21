"""Results of the verbs: rows, series and figures, and the tellers that present them."""
