"""Results of a run in words and tables, as the command line prints them and the page of a run shows them."""
