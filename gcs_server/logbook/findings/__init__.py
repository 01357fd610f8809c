"""Says what a log means: findings in plain sentences, each with its time, evidence, limit and remedy."""
