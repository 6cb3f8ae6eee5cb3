"""Pictures without a graphics card: triangles, z-buffers, light."""
