"""Why a query ends in "no", and the nearest pose that does not."""
