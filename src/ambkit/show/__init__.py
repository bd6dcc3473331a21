"""Every picture and page: what results look like, and the figure language that draws them."""
