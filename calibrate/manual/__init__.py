"""What of the manual is made from the code and from CONTRIBUTING: options, keys, parameters, equations, pictures.

`python -m zensical build --strict` builds the site of `docs/`; `zensical.toml` leads here.
"""
