"""How others see a run: web pages, and bridges to other systems."""
