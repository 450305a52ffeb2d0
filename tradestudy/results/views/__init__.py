"""What a results tree says, read once for figures and reports alike; nothing is drawn here."""
