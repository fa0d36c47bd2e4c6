"""Binary packages of Unreal Engine 3: tables, properties, brushes, built levels, static meshes.

The layout is that of worlds reference 5, with public notes on the format (UEViewer, MIT licence;
Unreal-Library). Everything that a file says is checked before it is believed.
"""
