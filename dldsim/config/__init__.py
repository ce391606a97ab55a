"""What a campaign is asked for: sections, presets, identifiers, seeds, hashes."""
