"""The programs that start several nodes: octo_arm_demo and octo_arm_octopus."""
