"""`python -m paig.libtorch`: finds libtorch, fetches it if it must, and prints the folder."""

import sys

from . import find
from ..errors import LibtorchError

try:
    print(find())
except LibtorchError as error:
    sys.exit(f"error: {error}")
except KeyboardInterrupt:
    sys.exit("interrupted; the next start continues the download")
