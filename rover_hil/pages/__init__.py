"""Result files of the commands: written whole or not at all."""
