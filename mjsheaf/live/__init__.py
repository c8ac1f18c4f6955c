"""A run in the browser while it proceeds.

Modules:

- live: the user's actions, the frames of the page, and the loop;
- server: HTTP and websocket for one client.
"""

PORT = 8765
"""Port on 127.0.0.1 of `--live`, Foxglove's own."""
