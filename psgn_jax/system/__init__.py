"""What touches the operating system: files, claims, untrusted input, cores, memory, signals."""
