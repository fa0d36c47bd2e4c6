"""`usarsim bench`: how many robots, cameras and INITs this machine holds."""
