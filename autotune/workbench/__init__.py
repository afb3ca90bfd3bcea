"""The model workbench: recordings and models in a browser, with the public face behind it."""
