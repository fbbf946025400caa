"""Questions, answers, pages: the command line, the residual loop, the studies."""
