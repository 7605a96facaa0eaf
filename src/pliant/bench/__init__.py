"""What pliant costs, measured beside others on the machine at hand; an error stands beside every time."""
