"""Pages of the documentation that are written from the code: `python -m tools.docs`.

What may live here: generators of Markdown and pictures below `docs/`, each a function of the project's root
that returns texts by path. Nothing here is part of the package.
"""
