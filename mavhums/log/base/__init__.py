"""What the decoders of all formats share: their interface, carry between blocks, tables, losses."""
