"""Videos of replays, drawn with matplotlib, which need neither a screen nor the viewer."""
