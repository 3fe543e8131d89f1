"""What the user sees: files written whole, the console, pages and pictures."""
