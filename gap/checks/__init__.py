"""What is wrong with a measured log itself, found before any physics is blamed. Entry: ``data_set``."""
