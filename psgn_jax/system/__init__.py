"""What touches the operating system: files, locks, untrusted input, cores, memory, signals."""
