"""The command `workspace`: maps, designs, files and figures."""
