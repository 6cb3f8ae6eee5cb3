"""Tables about whole mechanisms: IKSPARK's own (II to V, and its hand), loops and joints that follow others."""
