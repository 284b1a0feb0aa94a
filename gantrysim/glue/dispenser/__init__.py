"""The dispenser: valve, syringe and needle, and the lag of its flow."""
