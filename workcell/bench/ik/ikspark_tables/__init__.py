"""Tables VI and VII of IKSPARK, measured again."""
