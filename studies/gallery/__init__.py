"""Published experiments of cutting, computed: what had to come out, what was predicted and what is missed."""
