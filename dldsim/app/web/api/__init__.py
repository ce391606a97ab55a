"""HTTP interface of the design chain; holds no physics and no fitting."""
