"""What is on the page: scene, controls, plots and numbers. Imports ros/client."""
