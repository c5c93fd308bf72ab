"""What the nodes of pidtsm share: parameters, joint order, stamps, quality of service, life cycle and main loop."""
