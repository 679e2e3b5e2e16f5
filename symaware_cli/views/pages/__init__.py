"""Pages of HTML: templates, the blocks that they show, and printing."""
