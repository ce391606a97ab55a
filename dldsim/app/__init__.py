"""Commands, jobs of the rules, and the service."""
