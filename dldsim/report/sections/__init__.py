"""Chapters of the report: each takes the page and returns what its template shows."""
