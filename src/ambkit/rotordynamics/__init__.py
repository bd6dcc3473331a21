"""Critical speeds, mode shapes, unbalance response, modal reduction and balance grades."""
