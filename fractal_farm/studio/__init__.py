"""The studio: a local web application on a catalogue, and a static export of the same pages (DESIGN section 7).

`server` binds it to 127.0.0.1; `application` routes requests that `guard` let pass; `gallery` holds the columns that
the pages draw from; `workers` compute; `static_export` writes pages and data for any web host.
"""
