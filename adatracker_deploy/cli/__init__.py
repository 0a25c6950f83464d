"""The one command: a thin module for each subcommand; nothing here knows how anything is done."""
