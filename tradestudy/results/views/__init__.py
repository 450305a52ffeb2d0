"""What a results tree says, read once for figures and reports alike; nothing is drawn or put into sentences here."""
