"""What points of the robot keep out of and within, as rows on Z that are added where they are broken."""
