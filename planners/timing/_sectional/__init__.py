"""What laws built from sections share: ramps of the speed along s, sections, and stops."""
