"""`wsp studio`: recordings and a driving desk as pages in a browser, served to this machine alone.

The extra `studio` brings what the pages are made with. Nothing below knows this package; all work is done in child processes
(`work`), which call what the commands of the same name call.
"""
