"""What all commands share: options, questions, progress, output and exit codes."""
