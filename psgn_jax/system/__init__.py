"""The operating system: files, locks, untrusted input, cores, memory, signals."""
