"""From sound to vibration: detector, rendering and their order. The paper is here."""
