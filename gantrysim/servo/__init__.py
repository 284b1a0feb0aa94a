"""The sampled servo: gains, laws, drives, and the derivation of gains that keep their margins."""
