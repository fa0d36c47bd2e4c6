"""The operator console, measured with a server, a gateway, and pages in Chromium or in programs."""

ITEMS = {
    "con-02": "packages of the extra",
    "con-04": "sizes of page and scenes",
    "con-05": "first paint, scene complete",
    "con-07": "processors and memory for 0, 1, 8 pages",
    "con-08": "frames of the 3D tile",
    "con-12": "release of a key while the page is blocked",
    "con-15": "emergency stop beside hostile pages",
    "con-22": "a page that reads slowly",
    "o-37": "from key to wire, with and without 3D",
    "o-38": "age of pictures, 16 tiles, two pages, ten minutes",
}
"""What is measured, by the numbers of the checks, in the order in which it is taken."""
