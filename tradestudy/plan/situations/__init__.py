"""What a study asks for, piece by piece: the effects that matter to it, their bounds and costs, and who is chosen."""
