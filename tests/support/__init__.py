"""What tests share: arms, real nodes, judges and plants that others could have written."""
