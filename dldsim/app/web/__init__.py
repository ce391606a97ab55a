"""The design service: an API over the package (`api`) and a page that is its client (`ui`)."""
