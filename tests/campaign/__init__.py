"""The reliability campaign: kills, damage, faults and hostile input, seeded; see `__main__`."""
