"""A run in the browser while it proceeds.

Modules:

- live: the user's actions, the frames of the page, and the loop;
- server: HTTP and websocket for one client.
"""
