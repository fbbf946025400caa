"""Tables, figures, pages: formats what the experiments computed, and computes nothing itself."""

import logging

# Where HOME cannot be written, matplotlib keeps its fonts in a temporary folder, and says so in two long lines.
logging.getLogger("matplotlib").setLevel(logging.ERROR)
