"""The process that loads this, a fork server, leads a group: one signal ends it and all that it has forked."""

from __future__ import annotations

import os

if hasattr(os, "setpgrp"):
    os.setpgrp()
