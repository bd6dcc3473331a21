int amb_placeholder(void);int amb_placeholder(void){return 0;}
