"""What else goes wrong on a link, one impairment each."""
