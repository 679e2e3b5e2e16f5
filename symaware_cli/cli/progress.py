"""The bar that shows how far long work is."""

from symaware_cli.api.progress import progress as progress
