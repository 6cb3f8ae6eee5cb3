"""From files to compiled scenes: models, tasks, assets, and what drives their joints."""
