"""The viewer in the browser, `veriray view`.

`moves` turns cameras, `controls` holds what users set and checks what they send, `source` reads,
watches and writes the scene file, `display` makes bytes of a picture, `renderer` renders on a
thread of its own, `server` talks to browsers, and page.html, page.css and page.js are the page.
"""
