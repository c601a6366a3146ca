"""The files of a bag: storages, metadata, types of messages, and bounds on what they ask for.

May import wire, config, rod and arm; needs rosbags.
"""
