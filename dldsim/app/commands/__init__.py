"""Commands for one-off use, one file per group; `dldsim.app.cli` puts them together."""
