"""What the command ``sealegs`` can do, one module for each word; scripts of the checkout call the same."""
