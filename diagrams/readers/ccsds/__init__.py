"""Messages of the Consultative Committee for Space Data Systems: tracking data, ephemerides."""
