"""FTrace and its peers on rendered drives, and the scene that renders them."""
